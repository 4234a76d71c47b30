"""The experiments of the paper: its cases, figures, tables and printed errors."""
