"""What runs and pose files show: tables, charts, films, and the page of Table 1.

A table with many runs is made in this order:

- `blocks`: a block is all methods of a variant, changed in the same settings by `--set` or `--config`;
- `table1_plan`: a cell is a method on a sequence in a block, with a run for each seed;
- `table1`: an entry has the errors of a cell's runs, and a group has the entries that may be averaged. Each
  row of its table is a dictionary, which the code calls a record. The paper's own numbers are here, too;
- `table1_page`: the tables, sentences and figures of these groups, and the files of `vo reproduce`.

Beside them are `record`, a file with all numbers of a reproduction for others; `table1_durations`, how long
all of KITTI would take; and `paper_unit`, the unit of the paper's RE. `sweep_table` has the tables and maps
of `vo sweep`, with cells and records of its own. `compare` reads, measures and draws what `vo evaluate`
compares.

All of them use `page` (tables as text, and the report in HTML), `plots` (charts, and images with features),
`film` with `webm`, and `breaking` (long texts in lines).
"""
