"""Check how much memory a Parquet file takes once decoded, before decoding anything.

A file of some kilobytes may decode to gigabytes, and its footer may state less. So the page headers are read, which
determine what a reader decodes.
"""

from campaign.parquet_footer import column_chunks, pages

MOST = 2**30  # bytes: thirty times what the largest merged file takes


def check_decoded_size(content: bytes, stated: int, rows: int) -> None:
    """Check that a Parquet file has the expected number of rows in every column and does not decode to more than 1 GiB.

    `stated` is the number of rows in its footer. Raises ValueError, which says what is wrong, if it does not or if its
    footer or a page header is malformed.
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
