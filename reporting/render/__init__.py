"""Renderings of one analysis: HTML, JSON, Parquet, Excel, PDF."""
