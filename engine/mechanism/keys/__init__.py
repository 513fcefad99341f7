"""The keys of a mechanism's numbers: reading, setting and listing them."""
