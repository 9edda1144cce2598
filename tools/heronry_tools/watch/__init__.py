"""Watching a system: events in, one snapshot of everything that is known, and views of that snapshot.

A *feed* is where events come from: the manager on this computer, a bus alone (`live_feeds`), or a recording
(`recordings`). A *view* shows or writes snapshots: `heronry top`, `heronry web`, metrics, exports.
"""
