"""Videos of a test and of the ladder: a leaf, like the plots; nothing but the command line imports it."""
