"""Parameters of a mechanism file: numbers with a name, and the expressions that use them in place of numbers."""
