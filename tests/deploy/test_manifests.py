"""The manifests of Kubernetes fit their schemas, take an image by digest only, and keep what is promised of them."""

import subprocess
from importlib import resources

import jsonschema
import kubernetes_validate
import pytest
import yaml

from clearcap.web.settings import LOOPBACK, PORT
from tests.deploy.descriptors import DEPLOY, ROLES, check_dask, documents, output, pods, pods_in

DIGEST = f"sha256:{'0123456789abcdef' * 4}"


@pytest.mark.processes
@pytest.mark.parametrize("image", [f"clearcap@{DIGEST}", f"registry.example:5000/a/clear-cap_1@{DIGEST}"])
def test_an_image_by_digest(image):
    """It is put into every manifest that has an image."""
    manifests = [path for path in sorted((DEPLOY / "kubernetes").glob("*.yaml")) if "image:" in path.read_text()]
    assert len(manifests) == 4
    printed = output(DEPLOY / "kubernetes/with_image.sh", image, *manifests)
    assert "DIGEST" not in printed
    found = [pod["containers"][0]["image"] for document in yaml.safe_load_all(printed) for _, pod in pods_in(document)]
    assert found == [image] * len(list(pods()))


@pytest.mark.processes
@pytest.mark.parametrize(
    "image",
    ["", "clearcap", "clearcap:1.0", "clearcap@sha256:12", f"a|b@{DIGEST}", f"x@{DIGEST}\ny", f"y\nx@{DIGEST}"],
)
def test_an_image_without_digest(image):
    """It is refused, by its name, for the image's base and for manifests; so is what could change the command."""
    for command in ([DEPLOY / "has_digest.sh", image], [DEPLOY / "kubernetes/with_image.sh", image]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == f"{image}: not an image with its digest, such as registry.example/name@sha256:...\n"


def custom_schema(kind):
    """Return the schema of a resource of the operator, as its Helm chart installs it; unknown fields are refused."""
    folder = resources.files("dask_kubernetes").joinpath("operator/deployment/helm/dask-kubernetes-operator/crds")
    definition = yaml.safe_load(folder.joinpath(f"{kind.lower()}.yaml").read_text())
    schema = definition["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return closed({**schema, "properties": {**schema["properties"], "apiVersion": {}, "kind": {}, "metadata": {}}})


def closed(schema):
    """Return a schema that refuses fields it does not name, as ``kubectl apply`` does."""
    if not isinstance(schema, dict):
        return schema
    schema = {key: closed(value) if key != "properties" else value for key, value in schema.items()}
    if "properties" in schema:
        schema["properties"] = {key: closed(value) for key, value in schema["properties"].items()}
        if not schema.get("x-kubernetes-preserve-unknown-fields"):
            schema.setdefault("additionalProperties", False)
    return schema


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((DEPLOY / "kubernetes").glob("*.yaml")), ids=lambda path: path.name)
def test_kubernetes(path):
    """Each manifest is of Kubernetes' or the operator's own schema."""
    for manifest in documents(path):
        if manifest["apiVersion"].startswith("kubernetes.dask.org"):
            jsonschema.validate(manifest, custom_schema(manifest["kind"]))
        else:
            kubernetes_validate.validate(manifest, "1.31", strict=True)


def test_pods():
    """Every pod is unprivileged, writes to nothing of the image, and has the certificates of its role only."""
    seen = set()
    for name, pod in pods():
        seen.add(name)
        assert pod["securityContext"]["runAsNonRoot"]
        assert pod["automountServiceAccountToken"] is False
        for container in pod["containers"]:
            assert container["securityContext"]["readOnlyRootFilesystem"]
            assert not container["securityContext"]["allowPrivilegeEscalation"]
            assert container["securityContext"]["capabilities"]["drop"] == ["ALL"]
            assert container["image"] == "clearcap@DIGEST"
            assert container["resources"]["limits"]["memory"]
            assert {m["name"] for m in container["volumeMounts"]} == {v["name"] for v in pod["volumes"]}
        secrets = [volume["secret"]["secretName"] for volume in pod["volumes"] if "secret" in volume]
        assert secrets == ([f"clearcap-tls-{ROLES[name]}"] if ROLES[name] else [])
        if name in ("scheduler", "worker"):
            assert pod["restartPolicy"] == "Always"
            check_dask(pod["containers"][0]["args"])
    assert seen == set(ROLES)


def test_pages_are_behind_a_proxy_that_ends_tls():
    """The ingress has TLS for the server's name, and its probes ask by a name that the server has."""
    parts = {each["kind"]: each for each in documents(DEPLOY / "kubernetes/web.yaml")}
    [container] = parts["Deployment"]["spec"]["template"]["spec"]["containers"]
    words = container["args"]
    name = words[words.index("--name") + 1]
    assert "--behind-proxy" in words
    assert parts["Ingress"]["spec"]["tls"][0]["hosts"] == [name]
    assert [rule["host"] for rule in parts["Ingress"]["spec"]["rules"]] == [name]
    assert (parts["Deployment"]["spec"]["replicas"], parts["Deployment"]["spec"]["strategy"]["type"]) == (1, "Recreate")
    probes = {container[probe]["httpGet"]["path"] for probe in ("readinessProbe", "livenessProbe")}
    assert probes == {"/readyz", "/healthz"}
    for probe in ("readinessProbe", "livenessProbe"):
        assert container[probe]["httpGet"]["httpHeaders"] == [{"name": "Host", "value": LOOPBACK[2]}]
    [port] = container["ports"]
    assert port["containerPort"] == PORT == parts["Service"]["spec"]["ports"][0]["port"]


def test_kubernetes_has_the_same_dask_settings():
    """The ConfigMap is deploy/dask.yaml."""
    [manifest] = documents(DEPLOY / "kubernetes/dask.yaml")
    assert manifest["data"]["dask.yaml"] == (DEPLOY / "dask.yaml").read_text()


def test_secrets_are_a_pattern():
    """No key is in the repository."""
    for manifest in documents(DEPLOY / "kubernetes/secrets.yaml"):
        role = manifest["metadata"]["name"].removeprefix("clearcap-tls-")
        assert manifest["stringData"] == dict.fromkeys(("ca.pem", f"{role}.pem", f"{role}.key"), "")
