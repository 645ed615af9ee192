"""The commands of `matest`, one file each, and what they share: arguments and console.

The file of a command has a function of the same name, whose signature and docstring are arguments and help, and an
`EXAMPLE` that ends the help. Packages that take long to import are imported inside the function.
"""

# In the order of `matest --help`.
COMMANDS = (
    "init",
    "lights",
    "check",
    "estimate",
    "predict",
    "render",
    "fit",
    "compare",
    "export",
    "models",
    "benchmark",
)
