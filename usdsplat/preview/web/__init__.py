"""The preview in a browser, for machines without Qt or a display.

`server` listens, `guard` checks requests, `messages` defines what a page may request, `controller`
handles it, `outbox` holds what waits to be sent to a page, `frames` encodes pictures.
"""
