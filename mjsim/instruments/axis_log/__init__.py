"""What is measured: axis logs, the commanded and actual positions that a control recorded."""
