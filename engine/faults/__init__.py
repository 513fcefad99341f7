"""What is wrong with a file or a value, as data, and where in a text it stands."""
