"""The page of exports: the files of a campaign, its rows as a file, and the commands that do the same."""

from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.run_status import FailedStatus
from campaign.web.answers.exported_rows import FORMATS
from campaign.web.answers.sample_page import OK
from campaign.web.api.calls import PREFIX
from campaign.web.api.reports import report_files
from campaign.web.api.rows import ENDINGS
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import Asking, TheService
from campaign.web.pages.campaigns import frame
from campaign.web.pages.rendering import page

router = APIRouter(include_in_schema=False)
READERS = {  # Python imports and expression that read each format from an open answer
    "arrow": ("import pyarrow as pa", "pa.ipc.open_stream(answer).read_all()"),
    "parquet": ("import io\n\nimport pyarrow.parquet as pq", "pq.read_table(io.BytesIO(answer.read()))"),
    "csv": ("import pyarrow.csv", "pyarrow.csv.read_csv(answer)"),
}


class ExportForm(BaseModel):
    """The sent form of this page: the parameters of the call, but numbers may be empty, and columns are one text."""

    format: str = Field("parquet", pattern="^(arrow|parquet|csv)$")
    columns: str = Field("", max_length=20_000)
    first: str = Field("", pattern=r"^\d{0,15}$")
    last: str = Field("", pattern=r"^\d{0,15}$")
    status: str = Field("", max_length=40)

    def query(self) -> str:
        """Return the query of the equivalent API call."""
        asked = {"format": self.format, "columns": self.columns.replace(",", " ").split()}
        given = {"first": self.first, "last": self.last, "status": self.status}
        return urlencode(asked | {key: text for key, text in given.items() if text}, doseq=True)


@router.get("/campaigns/{campaign}/export")
async def export_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
    form: Annotated[ExportForm, Query()],
) -> Response:
    """Show the files and rows that can be exported, with the command and the Python lines that do the same."""
    files = await run_in_threadpool(report_files, service, campaign, who)
    call = f"{PREFIX}/campaigns/{campaign}/rows?{form.query()}"
    name = f"{campaign}.{ENDINGS[form.format]}"
    imports, reader = READERS[form.format]
    curl = f'curl -H "Authorization: Bearer $CLEARCAP_TOKEN" "{service.settings.address}{call}" -o {name}'
    python = [
        "import os",
        "import urllib.request",
        *imports.splitlines(),
        "",
        f'request = urllib.request.Request("{service.settings.address}{call}")',
        'request.add_header("Authorization", "Bearer " + os.environ["CLEARCAP_TOKEN"])',
        "with urllib.request.urlopen(request) as answer:",
        f"    rows = {reader}",
    ]
    values: dict[str, Any] = {"form": form, "files": files, "call": call, "name": name, "curl": curl}
    values |= {"python": "\n".join(python), "formats": list(FORMATS), "statuses": (OK, *FailedStatus)}
    return page(request, "export", **values, **await frame(request, service, campaign, who))
