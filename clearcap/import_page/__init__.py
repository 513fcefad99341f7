"""The page of ``clearcap mechanism import``: the parts in 3D, and a list of the joints and candidates found."""
