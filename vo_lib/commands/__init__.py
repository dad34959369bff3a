"""The `vo` command's commands, one module each: `add(commands)` declares the options and what runs."""
