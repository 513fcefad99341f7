"""The workers that compute a campaign: on this machine, of a dask scheduler, a batch system or Kubernetes."""
