"""Starting, loading, commanding and watching the suite's running processes from outside."""
