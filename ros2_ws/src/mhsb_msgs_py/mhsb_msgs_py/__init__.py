"""Names, QoS profiles, status codes and codecs between domain objects and standard ROS messages.

There are no algorithms here. A codec is one file with `encode` and `decode`. Decoding is strict: a
message that breaks its contract raises `MessageError` with one sentence.
"""
