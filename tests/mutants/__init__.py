"""Single-line faults that the tests must see, put into a copy of the tree one at a time."""
