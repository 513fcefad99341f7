"""The web service: pages and an HTTP API over a store. It keeps only accounts, audit, sign-offs and an index itself."""
