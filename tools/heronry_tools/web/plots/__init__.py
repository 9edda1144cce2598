"""Plots of variables: the samples of a datum from the bus, live or recorded, for a page that shows them.

    frames ─► tracks (samples of each source) ─► live: a stream for each page with a plot
                                             └─► recorded: the samples between two times, thinned

    state     who may change it                       without a plot
    tracks    live: the event loop, from frames that  there is none, and no frame is looked at
              the feed's thread has picked
              recorded: one thread at a time          none; those of the last variables are kept

A frame that is lost makes a gap once a reader would no longer use the datum before it. A frame that comes twice, from
two buses, counts once. A frame that a PE would refuse is counted, and not drawn. An invalid datum makes a gap. After a
restart of the server a live plot begins anew; the page keeps what it has.
"""
