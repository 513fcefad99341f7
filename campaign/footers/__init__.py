"""What the footer of a Parquet file says, read without decoding it, so that it can be refused before it does harm."""
