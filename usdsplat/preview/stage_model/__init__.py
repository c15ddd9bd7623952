"""What a stage holds, in rows that a window may show, and what a user may do to it.

Everything here takes a stage and belongs into a task of a session; what it returns is plain.
"""
