"""The data scripts, run by `vo data NAME`, and what they stand on: fetch (archives, imports) and training.

The package bears the name of its folder, so that a script is the same whether it is started as a file of the
checkout or out of an installed wheel; a plain `data` or `scripts` would take a name that others use as well.
"""
