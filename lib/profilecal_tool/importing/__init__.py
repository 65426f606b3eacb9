"""A scan from files that people have: tables of any kind, robots' programs, arrays."""
