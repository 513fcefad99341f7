"""Where a campaign is computed, as a user says it."""

from campaign.cluster.cluster import Cluster


def test_cluster_options_survive_a_detached_start():
    """The words of a command that describe a cluster describe the same one again."""
    words = Cluster("tcp://127.0.0.1:8786", insecure=True).options()
    assert words == ["--scheduler", "tcp://127.0.0.1:8786", "--insecure"]
    assert Cluster(workers=3).options() == ["--workers", "3"]
    assert Cluster(kind="slurm", workers=8).options() == ["--cluster", "slurm", "--workers", "8"]
