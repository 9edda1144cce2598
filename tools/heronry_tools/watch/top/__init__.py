"""`heronry top`: a snapshot in a terminal. `panels` writes it as text, `app` shows it, `sources` feeds it."""
