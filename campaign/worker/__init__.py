"""The work of a worker: it turns a batch request into rows and writes them as one part of the store."""
