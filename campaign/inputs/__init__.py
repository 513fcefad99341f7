"""The inputs that vary: distributions of the variables, and the samplers that draw from them."""
