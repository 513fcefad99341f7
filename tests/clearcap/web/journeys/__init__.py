"""The service as a user has it: a server of its own, a browser, and a keyboard."""
