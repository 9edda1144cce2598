"""`heronry web`: a process that serves a page with the snapshots (`heronry_tools.watch`) of a system.

    feed (manager, bus, log) ─► live or recording ─► changes ─► one stream for each open page
    page ─► guard ─► questions ─► process of the planner         what if, why, what an order will cost
                  └► orders ─► operator's socket, or demo        only with --operate and the token

In this diagram `live`, `recording`, `changes`, `guard`, `questions` and `orders` are files of this package. The page is
hand-written HTML, CSS and JavaScript in `page/`. Nothing is fetched from another computer. Neither the manager nor an
agent imports this package.
"""
