"""What a run looks like: a page in the browser, animations."""
