"""Environment variables of the command."""

STORE = "CLEARCAP_STORE"  # the store, if no option names one; unlike options, other users cannot read it
SERVER = "CLEARCAP_SERVER"  # the address of a server to use in place of a store
TOKEN = "CLEARCAP_TOKEN"  # the access token for the server; unlike options, other users cannot read it
