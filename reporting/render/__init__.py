"""One analysis, many renderings: HTML, JSON, Parquet, Excel, PDF."""
