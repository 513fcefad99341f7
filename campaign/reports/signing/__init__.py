"""Sign-offs: who approved which bytes of a campaign, in a document that anybody can verify without the server."""
