"""Environment variables of the command."""

STORE = "CLEARCAP_STORE"  # the store, where no option names one: other users of a machine cannot read it there
SERVER = "CLEARCAP_SERVER"  # the address of a server that is asked in place of a store
TOKEN = "CLEARCAP_TOKEN"  # what a server knows a program by: other users of a machine cannot read it there
