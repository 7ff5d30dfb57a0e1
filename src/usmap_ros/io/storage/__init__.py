"""The files that a recording consists of: MCAP and sqlite3, whole or damaged.

Reading takes two passes.  `Storage.scan` walks through the file once, checks it and notes where
each message lies and its stamp, 40 bytes a message.  `Storage.payload` then fetches messages in
whatever order is wanted.  So messages come in exact stamp order, however the recorder
interleaved robots, from a memory that does not grow with the size of the recording.
"""

from usmap_ros.io.storage.files import is_recording, open_storage
from usmap_ros.io.storage.index import Damage, MessageIndex, RecordedTopic, Storage

__all__ = ["Damage", "MessageIndex", "RecordedTopic", "Storage", "is_recording", "open_storage"]
