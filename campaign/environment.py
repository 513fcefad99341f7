"""Environment variables of the command."""

STORE = "CLEARCAP_STORE"  # the store, where no option names one: other users of a machine cannot read it there
