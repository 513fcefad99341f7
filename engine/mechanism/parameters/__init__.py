"""Parameters of a mechanism file: named numbers, and the expressions that use them in place of numbers."""
