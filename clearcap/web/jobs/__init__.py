"""Jobs for the processes of the server: functions from plain data to plain data or bytes, run within limits."""
