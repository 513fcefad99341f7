"""Physics of one mechanism with one set of clearances: nonsmooth contact dynamics."""
