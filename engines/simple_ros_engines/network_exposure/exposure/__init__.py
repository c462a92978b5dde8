"""The network's interfaces: SEAL, NEF AsSessionWithQoS, CAMARA Quality-on-Demand."""
