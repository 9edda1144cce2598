"""Why a function is not served, or not as well as it could be, and what would repair it."""
