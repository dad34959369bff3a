"""The `vo` command's commands, one module each: `add(parser)` declares the options and what runs."""
