"""How much memory a Parquet file takes once it is decoded, known before anything is.

A file of some kilobytes may decode to gigabytes, and its footer may say otherwise. So the headers of its pages, which
are what a reader goes by, are read.
"""

from campaign.footers.column_chunks import column_chunks, pages

MOST = 2**30  # bytes: thirty times what the largest merged file takes


def check_decoded_size(content: bytes, stated: int, rows: int) -> None:
    """Check that a Parquet file holds this number of rows in every column, and no more memory than a file of rows may.

    Parameters
    ----------
    content : bytes
        Of the file.
    stated : int
        Number of rows by its footer.
    rows : int
        Number of rows that it must have.

    Raises
    ------
    ValueError
        If it does not, or its footer or a page header is not sound; the message says what is wrong.
    """
    if stated != rows:
        raise ValueError(f"its footer says {stated} rows in place of {rows}")
    size = 0
    for chunk in column_chunks(content):
        for uncompressed, values in pages(content, chunk):
            size += uncompressed
            if values > rows or size > MOST:
                raise ValueError(f"it decodes to more than a file of {rows} rows may ({MOST >> 20} MB)")
        if chunk.values != chunk.rows or chunk.rows > rows:
            raise ValueError("its columns have different numbers of rows")
