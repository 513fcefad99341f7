"""The service: pages and an HTTP API over a store. Nothing but accounts, audit, sign-offs and an index is kept here."""
