"""What the play of the C-60's parts along their axes does to its responses: the table of docs/c60-force.md.

The drawings tell how much play the parts have between case and cover; where in it they are is not known. Each play
starts the same samples elsewhere, or gives them more play than is drawn. Nothing is fitted.
"""
