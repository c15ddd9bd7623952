"""Compress the text messages of a socket (RFC 7692), not the binary ones.

The descriptions of the settings alone are 20 kB of JSON, 0.2 s of a link of 1 Mbit/s. Images are
compressed already, and deflating them again would cost more time than sending them on this machine.
"""

from __future__ import annotations

from collections.abc import Sequence

from websockets.extensions import Extension
from websockets.extensions.permessage_deflate import (
    PerMessageDeflate,
    ServerPerMessageDeflateFactory,
)
from websockets.frames import Frame, Opcode
from websockets.typing import ExtensionParameter


class TextDeflate(PerMessageDeflate):
    """permessage-deflate that leaves binary messages as they are, as RFC 7692 7.2.1 permits."""

    def encode(self, frame: Frame) -> Frame:
        """Compress a frame of a text message. Our messages have one frame each."""
        return frame if frame.opcode is Opcode.BINARY else super().encode(frame)


class TextDeflateFactory(ServerPerMessageDeflateFactory):
    """Negotiates `TextDeflate`."""

    def process_request_params(
        self, params: Sequence[ExtensionParameter], accepted_extensions: Sequence[Extension]
    ) -> tuple[list[ExtensionParameter], PerMessageDeflate]:
        """Return the answer to a request for compression, and the extension."""
        answer, agreed = super().process_request_params(params, accepted_extensions)
        return answer, TextDeflate(
            agreed.remote_no_context_takeover,
            agreed.local_no_context_takeover,
            agreed.remote_max_window_bits,
            agreed.local_max_window_bits,
            agreed.compress_settings,
        )
