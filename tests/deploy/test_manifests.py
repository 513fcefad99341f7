"""The manifests of Kubernetes fit their schemas, take an image by digest only, and keep what is promised of them."""

import shutil
import subprocess
from importlib import resources

import jsonschema
import kubernetes_validate
import pytest
import yaml

from campaign.store.layout import HEARTBEAT, SERVICE
from clearcap.web.settings import LOOPBACK, PORT
from tests.deploy.descriptors import DEPLOY, MANIFESTS, ROLES, check_dask, documents, needs, output, pods, pods_in

DIGEST = f"sha256:{'0123456789abcdef' * 4}"


@pytest.mark.processes
@pytest.mark.parametrize("image", [f"clearcap@{DIGEST}", f"registry.example:5000/a/clear-cap_1@{DIGEST}"])
def test_an_image_by_digest(image):
    """It is put into every manifest that has an image."""
    manifests = [path for path in MANIFESTS if "image:" in path.read_text()]
    assert len(manifests) == 4
    printed = output(DEPLOY / "kubernetes/with_image.sh", image, *manifests)
    assert "DIGEST" not in printed
    found = [pod["containers"][0]["image"] for document in yaml.safe_load_all(printed) for _, pod in pods_in(document)]
    assert found == [image] * len(list(pods()))


@pytest.mark.processes
@pytest.mark.parametrize(
    "image", ["", "clearcap", "clearcap:1.0", "clearcap@sha256:12", f"a|b@{DIGEST}", f"x@{DIGEST}\ny", f"y\nx@{DIGEST}"]
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
@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.name)
def test_kubernetes(path):
    """Each manifest is of Kubernetes' or the operator's own schema."""
    for manifest in documents(path):
        if manifest["apiVersion"].startswith("kubernetes.dask.org"):
            jsonschema.validate(manifest, custom_schema(manifest["kind"]))
        else:
            kubernetes_validate.validate(manifest, "1.31", strict=True)


@needs("kubectl", "kubernetes-client")
@pytest.mark.processes
@pytest.mark.slow  # no package index of systems has a kubectl that is new enough, so CI cannot ask for one
def test_kustomizations(tmp_path):
    """Base and overlays are built; an overlay adds to its base, and has the site's values at their places."""
    shutil.copytree(DEPLOY / "kubernetes", tmp_path / "k")
    site = tmp_path / "k/overlays/pages/site.yaml"
    values = {"host: clearcap.example": "host: a.plant", "10.0.0.0/8 ": "10.9.0.0/16 ", ": nginx": ": other"}
    for before, after in values.items():
        assert before in site.read_text()
        site.write_text(site.read_text().replace(before, after))
    built = {}
    for folder in ("base", "overlays/pages", "overlays/url"):
        made = list(yaml.safe_load_all(output("kubectl", "kustomize", tmp_path / "k" / folder)))
        built[folder] = {(each["kind"], each["metadata"]["name"]): each for each in made}
    assert set(built["base"]) < set(built["overlays/pages"]) < set(built["overlays/url"])
    listed = {(each["kind"], each["metadata"]["name"]) for path in (DEPLOY / "kubernetes/base").glob("*.yaml")
              for each in documents(path) if each["kind"] != "Kustomization"}  # fmt: skip
    assert set(built["base"]) == listed
    pages = built["overlays/pages"]
    assert ("ConfigMap", "clearcap-site") not in pages
    words = pages["Deployment", "clearcap-web"]["spec"]["template"]["spec"]["containers"][0]["args"]
    assert (words[words.index("--name") + 1], words[words.index("--proxy") + 1]) == ("a.plant", "10.9.0.0/16")
    ingress = pages["Ingress", "clearcap-web"]["spec"]
    assert (ingress["ingressClassName"], ingress["rules"][0]["host"], ingress["tls"][0]["hosts"]) == (
        "other", "a.plant", ["a.plant"]
    )  # fmt: skip


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
    parts = {each["kind"]: each for each in documents(DEPLOY / "kubernetes/overlays/pages/web.yaml")}
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


def test_a_coordinator_that_hangs_is_restarted():
    """Its probe looks at what it writes every two seconds."""
    [coordinator] = documents(DEPLOY / "kubernetes/base/coordinator.yaml")
    [container] = coordinator["spec"]["template"]["spec"]["containers"]
    store = container["args"][container["args"].index("--store") + 1]
    assert f"{store}/{SERVICE}/{HEARTBEAT}" in container["livenessProbe"]["exec"]["command"][-1]


def test_kubernetes_has_the_same_dask_settings():
    """The ConfigMap is deploy/dask.yaml."""
    [manifest] = documents(DEPLOY / "kubernetes/base/dask.yaml")
    assert manifest["data"]["dask.yaml"] == (DEPLOY / "dask.yaml").read_text()


def test_secrets_are_a_pattern():
    """No key is in the repository."""
    for manifest in documents(DEPLOY / "kubernetes/secrets.yaml"):
        role = manifest["metadata"]["name"].removeprefix("clearcap-tls-")
        assert manifest["stringData"] == dict.fromkeys(("ca.pem", f"{role}.pem", f"{role}.key"), "")
