"""What a worker does: a batch request becomes rows and one part of the store."""
