"""The commands of `vo`.

`demo`, `run`, `reproduce`, `sweep`, `evaluate`, `list_sequences`, `check_installation`, `data_scripts` and
`lab` are a command each: `add(parser)` declares its options and the function to call. `cli` lists and calls
them.

They share `console` (parser, messages, tables; `table_layout` breaks the tables), `common` (options, runs
with a progress bar), `vehicle_boxes` (--detector and --labels) and `close_loops` (--loops). `carry_over`
belongs to `lab`.
"""
