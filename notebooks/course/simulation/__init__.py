"""Problems with a known answer, without images or beside them.

`problems` draws single pairs of views, `tracks` makes matches along any trajectory, and `drives` turns both into frames
for the cells. `lorry` adds a lorry to the matches of a sequence, `given_boxes` gives it other boxes, `mismatches` has
wrong positions, and `true_matches` reads the truth of drawn scenes.
"""
