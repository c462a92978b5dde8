// The conversation of conversation.mjs in Node; what was heard is printed as JSON.
// usage: node client.mjs URL SUBPROTOCOL
import protocol from "@foxglove/ws-protocol";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor/index.js";
import { WebSocket } from "ws";

import { converse } from "./conversation.mjs";

const [url, subprotocol] = process.argv.slice(2);
console.log(await converse(protocol.FoxgloveClient, protobuf, new WebSocket(url, [subprotocol])));
