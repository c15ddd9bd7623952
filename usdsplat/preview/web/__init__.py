"""The preview in a browser, for machines without Qt or a display.

`server` listens, `guard` decides who is let in, `messages` are what a page may ask for,
`controller` does it, `outbox` holds what a page is to be told, `frames` are pictures on their way.
"""
