"""Makes the solids of the machine model and writes the model's folder.

The two MJCF files are no product of this package: they are text in ``models/``, edited by hand, and copied as they are.
"""
