"""A Go2 as its own kit sends it: low states at a steady rate on loopback, with Cyclone DDS. Arguments: domain, messages, hertz, what else
(`-`, `die`: ends at once without a word; `garbage`: sends bytes that are no DDS to the ports beside)."""

import os
import socket
import sys
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from unitree_sdk2py.idl.default import unitree_go_msg_dds__LowState_
from unitree_sdk2py.idl.unitree_go.msg.dds_ import LowState_

domain, count, hertz, what = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), sys.argv[4]
participant = DomainParticipant(domain)
writer = DataWriter(participant, Topic(participant, "rt/lowstate", LowState_))
message = unitree_go_msg_dds__LowState_()
# Until the other side is there: what is sent before is nobody's.
deadline = time.monotonic() + 30
while not writer.get_matched_subscriptions() and time.monotonic() < deadline:
    time.sleep(0.05)
time.sleep(1.0)
print("begun", flush=True)
noise = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
begun = time.monotonic()
for k in range(count):
    message.tick = k
    for joint in range(12):
        message.motor_state[joint].q = 0.001 * joint + 1e-6 * k
    writer.write(message)
    if what == "garbage":
        for port in range(7400 + 250 * domain, 7400 + 250 * domain + 30):
            head = b"RTPS\x02\x03\x01\x10" if k % 2 else b""
            noise.sendto(head + os.urandom(200), ("127.0.0.1", port))
    wait = begun + (k + 1) / hertz - time.monotonic()
    if wait > 0:
        time.sleep(wait)
print("sent", count, flush=True)
if what == "die":
    os._exit(9)
time.sleep(2.0)
