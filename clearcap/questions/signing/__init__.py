"""Sign-offs: signed documents on who approved which bytes of a campaign, verifiable by anybody without the server."""
