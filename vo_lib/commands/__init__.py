"""The commands of `vo`, one module each: `add(parser)` declares the options and the function to call."""
