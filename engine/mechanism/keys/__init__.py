"""The keys of a mechanism's numbers: to read and set them, and to list them."""
