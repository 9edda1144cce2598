"""`heronry web`: a process that serves a page with the snapshots (`heronry_tools.watch`) of a system.

    feed (manager, bus, log) ─► live or recording ─► changes ─► one stream for each open page
    frames of the feed ─► plots ─► a stream for each page with a plot      none is read without one
    page ─► guard ─► questions ─► process of the planner         what if, why, what an order will cost
                  └► orders of `watch` ─► manager, or demo      only with --operate and the token

In this diagram `plots` is a package; `live`, `recording`, `changes`, `guard` and `questions` are files of this package.
The page is hand-written HTML, CSS and JavaScript in `page/`, except `page/uplot/`, which draws charts. Nothing is
fetched from another computer. Neither the manager nor an agent imports this package.
"""
