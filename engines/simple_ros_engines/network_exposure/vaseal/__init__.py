"""The network as consumer of what applications expose (VASEAL): the roles and where they are.

| role | here |
|---|---|
| VASEAL Service Server | `vaseal.node`: event monitoring and resource management of the applications beside it |
| VASEAL Service Client | the page of scores (`mos`): what the applications and the network say, for people |
| Network Layer Service Client | `vaseal.network_client`: tells the network, takes what it asks for |
| Network Layer Service Server | `mock.vaseal_api`: the network's side, in the mock network |

There is no standard for the interface of the last two; this one is ours.
"""
