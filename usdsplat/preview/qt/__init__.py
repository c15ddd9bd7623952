"""The window: Qt widgets over plain values. Nothing here touches a stage, a file or an engine."""
