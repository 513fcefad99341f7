"""What the processes of the server compute: plain data or bytes from plain data, each within limits."""
