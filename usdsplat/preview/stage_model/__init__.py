"""The contents of a stage as rows for a user interface, and the edits that users make.

Every function takes a stage and runs in a task of the session; results are plain values.
"""
