"""Names, QoS profiles, status codes and codecs between domain objects and standard ROS messages.

No algorithms. A codec is one file with `encode` and `decode`; decoding is strict, and what it
refuses raises `MessageError` with one sentence.
"""
