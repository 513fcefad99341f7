"""Read the footer of a Parquet file without decoding the data, so that a harmful file can be refused beforehand."""
