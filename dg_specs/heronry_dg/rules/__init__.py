"""The rules of `heronry check` as data: one file per family of codes."""
