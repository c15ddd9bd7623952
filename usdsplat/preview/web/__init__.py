"""The preview in a browser, for machines without Qt or a display.

`server` listens, `guard` checks requests, `messages` defines what a page may request, `controller`
handles it, with `commands` for what needs only the viewer. `pages` knows who drives, `outbox` holds
what waits to be sent to a page, `stream` chooses how well its pictures are encoded by what `link`
measures, and `frames` encodes them.
"""
