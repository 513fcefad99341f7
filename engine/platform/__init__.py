"""Tools of the machine and its files: folders, TOML, the clock, the build, linear algebra without surprises."""
