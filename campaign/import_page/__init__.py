"""What ``clearcap mechanism import`` found, as one page: the parts in 3D, and a list of joints and candidates."""
