"""Which tests run where."""

import os

# Contacts of links with each other are compiled apart, which takes longer than all of their tests
# without the compiler: test_architecture.py runs them so. EVERY_METHOD=1 compiles them.
collect_ignore = []
if not os.environ.get('EVERY_METHOD') and not os.environ.get('NUMBA_DISABLE_JIT'):
    collect_ignore.append('test_self_contact.py')
