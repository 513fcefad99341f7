"""Which pods reach what, as Kubernetes reads the network policies of deploy/kubernetes."""

from functools import cache
from ipaddress import ip_address, ip_network
from pathlib import Path

import pytest
import yaml

KUBERNETES = Path(__file__).parents[2] / "deploy/kubernetes"


def labels(build, *before):
    """Return the labels that the operator gives a pod of a cluster called clearcap."""
    made = build(*before, {}, {})
    return made["spec"].get("template", made)["metadata"]["labels"]


@cache
def pods():
    """Return the labels of each kind of pod; the operator takes two seconds to import, in each process of the tests."""
    from dask_kubernetes.operator.controller import controller

    coordinator = yaml.safe_load((KUBERNETES / "base/coordinator.yaml").read_text())
    pod = {"containers": [{"name": "", "env": []}]}
    return {
        "scheduler": labels(controller.build_scheduler_deployment_spec, "clearcap", pod),
        "worker": labels(controller.build_worker_deployment_spec, "default", "ns", "clearcap", "1", pod),
        "job-runner": labels(controller.build_job_pod_spec, "clearcap", "clearcap", "ns", pod),
        "coordinator": coordinator["spec"]["template"]["metadata"]["labels"],
        "web": {"app.kubernetes.io/name": "clearcap", "app.kubernetes.io/component": "web"},
        "stranger": {"app": "other"},
    }


KINDS = "scheduler", "worker", "job-runner", "coordinator", "web", "stranger"
INGRESS = {"kubernetes.io/metadata.name": "ingress-nginx"}, {"app.kubernetes.io/name": "ingress-nginx"}
PROMETHEUS = {"kubernetes.io/metadata.name": "monitoring"}, {"app.kubernetes.io/name": "prometheus"}
NAMES = {"kubernetes.io/metadata.name": "kube-system"}, {"k8s-app": "kube-dns"}


def policies(*names):
    """Return the policies of files."""
    return [policy for name in names for policy in yaml.safe_load_all(next(KUBERNETES.rglob(name)).read_text())]


def selected(selector, labels):
    """Tell whether a selector takes what has these labels."""
    wanted = all(labels.get(key) == value for key, value in selector.get("matchLabels", {}).items())
    for rule in selector.get("matchExpressions", []):
        assert rule["operator"] == "NotIn"
        wanted &= labels.get(rule["key"]) not in rule["values"]
    return wanted


def peer(rule, other):
    """Tell whether one end of a rule is a pod (its labels, or those of its namespace and its own) or an address."""
    if isinstance(other, str):
        block = rule.get("ipBlock")
        return (
            bool(block)
            and ip_address(other) in ip_network(block["cidr"])
            and not any(ip_address(other) in ip_network(each) for each in block.get("except", []))
        )
    namespace, labels = other if isinstance(other, tuple) else ({}, other)
    if "ipBlock" in rule or bool(namespace) != ("namespaceSelector" in rule):
        return False
    return selected(rule.get("namespaceSelector", {}), namespace) and selected(rule.get("podSelector", {}), labels)


def lets(policies, way, pod, other, port):
    """Tell whether the policies of a pod let traffic pass one way, Ingress or Egress."""
    ours = [p["spec"] for p in policies if way in p["spec"]["policyTypes"] and selected(p["spec"]["podSelector"], pod)]
    key, ends = way.lower(), {"Ingress": "from", "Egress": "to"}[way]
    return not ours or any(
        any(peer(each, other) for each in rule[ends])
        and ("ports" not in rule or port in [(each["protocol"], each["port"]) for each in rule["ports"]])
        for spec in ours
        for rule in spec.get(key, [])
    )


def connects(found, source, target, port):
    """Tell whether a pod reaches another one, or an address."""
    other = pods().get(target, target)
    out = lets(found, "Egress", pods()[source], other, port)
    return out and (target not in KINDS or lets(found, "Ingress", other, pods()[source], port))


def test_every_kind_of_pod_is_asked():
    assert set(KINDS) == set(pods())


def test_who_reaches_whom():
    """The coordinator reaches the scheduler's port; the pods of the cluster each other; nobody else anything."""
    found = policies("network.yaml")
    cluster = {"scheduler", "worker", "job-runner"}
    for port in (8786, 40000):
        reached = {(a, b) for a in KINDS for b in KINDS if connects(found, a, b, ("TCP", port))}
        expected = {(a, b) for a in cluster for b in cluster}
        assert reached == expected | ({("coordinator", "scheduler")} if port == 8786 else set())


def test_who_reaches_the_pages():
    """The ingress controller and Prometheus alone, and only their port."""
    found = policies("network.yaml")
    for peer_of_pages in (INGRESS, PROMETHEUS):
        assert lets(found, "Ingress", pods()["web"], peer_of_pages, ("TCP", 8700))
        assert not lets(found, "Ingress", pods()["web"], peer_of_pages, ("TCP", 22))
    assert not lets(found, "Ingress", pods()["web"], (PROMETHEUS[0], {"app": "other"}), ("TCP", 8700))
    assert not any(connects(found, pod, "web", ("TCP", 8700)) for pod in KINDS)
    assert not any(lets(found, "Ingress", pods()[pod], INGRESS, ("TCP", 8700)) for pod in KINDS if pod != "web")


@pytest.mark.parametrize("pod", KINDS)
def test_what_is_outside(pod):
    """Every pod may look up names, and reaches neither the internet nor the API server nor the clouds' metadata."""
    found = policies("network.yaml")
    assert lets(found, "Egress", pods()[pod], NAMES, ("UDP", 53))
    assert not lets(found, "Egress", pods()[pod], NAMES, ("TCP", 443))
    for address in ("93.184.216.34", "10.96.0.1", "169.254.169.254"):
        assert not connects(found, pod, address, ("TCP", 443))


def test_a_store_behind_a_url():
    """With network-url.yaml all but the scheduler reach TLS servers, but neither clouds' metadata nor other ports."""
    found = policies("network.yaml", "network-url.yaml")
    for pod in KINDS:
        assert connects(found, pod, "93.184.216.34", ("TCP", 443)) == (pod != "scheduler")
        assert not connects(found, pod, "93.184.216.34", ("TCP", 80))
        assert not connects(found, pod, "169.254.169.254", ("TCP", 443))
