"""An API of Kubernetes on loopback that knows one kind of resource, for tests."""

import json
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import yaml


class _Api(BaseHTTPRequestHandler):
    """Keeps resources in the server's table ``resources`` and every change in its list ``changes``."""

    def log_message(self, *words):
        """Say nothing."""

    def _answer(self, code, content):
        body = json.dumps(content).encode()
        self.send_response(code)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _nothing(self):
        self._answer(404, {"kind": "Status", "status": "Failure", "code": 404, "message": "not found"})

    def _content(self):
        return json.loads(self.rfile.read(int(self.headers.get("Content-Length", 0))) or b"{}")

    def do_GET(self):
        """Give the version or a resource."""
        path = self.path.partition("?")[0].rstrip("/")
        if path == "/version":
            self._answer(200, {"major": "1", "minor": "31", "gitVersion": "v1.31.0"})
        elif path in self.server.resources:
            self._answer(200, self.server.resources[path])
        else:
            self._nothing()

    def do_POST(self):
        """Create a resource."""
        content = self._content()
        if content["spec"]["worker"]["replicas"] == self.server.refused:
            self._answer(422, {"kind": "Status", "status": "Failure", "code": 422, "message": "too many"})
            return
        name = content["metadata"]["name"]
        self.server.changes.append(("created", name, content["spec"]["worker"]["replicas"]))
        path = f"{self.path.partition('?')[0].rstrip('/')}/{name}"
        self.server.resources[path] = content
        self._answer(201, content)

    def do_DELETE(self):
        """Delete a resource."""
        self._content()
        path = self.path.partition("?")[0]
        if path not in self.server.resources:
            self._nothing()
            return
        self.server.changes.append(("deleted", self.server.resources.pop(path)["metadata"]["name"]))
        self._answer(200, {"kind": "Status", "status": "Success"})


@contextmanager
def kubernetes_api(folder, refused=None):
    """Serve the API; yield the server, the path of a kubeconfig being its attribute ``config``."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Api)
    server.resources, server.changes, server.refused = {}, [], refused
    server.config = folder / "kubeconfig"
    url = f"http://127.0.0.1:{server.server_address[1]}"
    server.config.write_text(
        yaml.safe_dump(
            {
                "apiVersion": "v1",
                "kind": "Config",
                "clusters": [{"name": "test", "cluster": {"server": url}}],
                "users": [{"name": "test", "user": {"token": "test"}}],
                "contexts": [{"name": "test", "context": {"cluster": "test", "user": "test", "namespace": "labs"}}],
                "current-context": "test",
            }
        )
    )
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
