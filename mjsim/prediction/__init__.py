"""The error that a part will have: any program run on the diagnosed machine."""
