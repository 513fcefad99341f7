"""Where a campaign is computed: local workers, a dask scheduler, a batch system, Kubernetes."""
