"""Verbs that serve other processes: a coordinator, a web server, and the certificates of a cluster."""
