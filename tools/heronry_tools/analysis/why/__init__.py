"""Why a function is not served, or not as well as it could be, and which repairs would change that."""
