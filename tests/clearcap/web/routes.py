"""All routes of the service, as its routers have them now: what tests ask of each, a new one cannot escape."""

from dataclasses import dataclass

from fastapi.routing import APIRoute

from clearcap.web.access import Role
from clearcap.web.api import routers
from clearcap.web.http.authentication import SAFE_METHODS, RoleNeeded, authenticated, needs_all_campaigns
from clearcap.web.pages import page_routers


@dataclass(frozen=True)
class Way:
    """One method of one route.

    Attributes
    ----------
    method, path : str
        As `POST` and `/api/v1/campaigns/{campaign}/cancel`.
    route : APIRoute
        It has the parameters and what it depends on.
    """

    method: str
    path: str
    route: APIRoute

    def __str__(self):
        return f"{self.method} {self.path}"

    @property
    def is_write(self):
        """Whether it may change something."""
        return self.method not in SAFE_METHODS

    @property
    def calls(self):
        """What is called before it is answered."""
        return list(_calls(self.route.dependant))

    @property
    def needs_login(self):
        """Whether it asks who asks."""
        return authenticated in self.calls

    @property
    def is_open_to_shares(self):
        """Whether it also asks nothing more of whoever came by a shared link."""
        return not any(isinstance(call, RoleNeeded) or call is needs_all_campaigns for call in self.calls)

    @property
    def role(self):
        """The least role that it asks for by itself; a viewer if it names none."""
        found = [call.role for call in self.calls if isinstance(call, RoleNeeded)]
        return max(found, default=Role.VIEWER)

    def url(self, **values):
        """Return its path with values for its parameters: those given, then numbers or words that fit."""
        fitting = {name: values.get(name, _fitting(self.route, name)) for name in self.route.param_convertors}
        return self.path.format(**fitting)


def all_ways():
    """Return all methods of all routes."""
    found = []
    for router in (*routers(), *page_routers()):
        for route in router.routes:
            assert isinstance(route, APIRoute), f"{route} hides routes; list its router by itself"
            found += [Way(method, route.path, route) for method in sorted(route.methods)]
    return found


def _calls(dependant):
    """Yield all that a route depends on."""
    for dependency in dependant.dependencies:
        yield dependency.call
        yield from _calls(dependency)


def _fitting(route, name):
    """Return a value for a parameter of a path, of its kind."""
    fields = [field for dependant in _dependants(route.dependant) for field in dependant.path_params]
    kinds = [field.field_info.annotation for field in fields if field.alias == name]
    return 1 if int in kinds else "word"


def _dependants(dependant):
    yield dependant
    for dependency in dependant.dependencies:
        yield from _dependants(dependency)
