"""Downloads of files and tables, which a server sends piece by piece."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from campaign.client.server_connection import ServerConnection
from campaign.errors import StoreError, unwritable

if TYPE_CHECKING:
    import pyarrow as pa

PIECE = 1 << 20  # bytes


def download(connection: ServerConnection, path: str, file: Path) -> Path:
    """Download a file and return its path; it appears there only when it is complete.

    Raises CampaignError if the server refuses, the connection is lost, or the file cannot be written.
    """
    partial = file.with_name(f"{file.name}.partial")
    with connection.stream(path) as response:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with partial.open("wb") as written:
                for piece in response.iter_bytes(PIECE):
                    written.write(piece)
            partial.replace(file)
        except OSError as error:
            raise unwritable(f"{file}: cannot be written ({error.strerror or error})", error) from error
        finally:
            partial.unlink(missing_ok=True)
    return file


def downloaded_table(connection: ServerConnection, path: str, params: dict[str, Any]) -> "pa.Table":
    """Return a table that a server sends as an Arrow stream.

    Raises CampaignError if the server refuses, the connection is lost, or the answer is not a table.
    """
    import pyarrow as pa

    with connection.stream(path, params=params) as response:
        content = pa.BufferOutputStream()
        for piece in response.iter_bytes(PIECE):
            content.write(piece)
    try:
        return pa.ipc.open_stream(content.getvalue()).read_all()
    except pa.ArrowException as error:
        raise StoreError(f"server {connection.address}: what it sent is not a table ({error})") from error
