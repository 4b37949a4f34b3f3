"""Tables of the documentation, made from stored results."""
