// One conversation of npm @foxglove/ws-protocol with a bridge: the same in Node (client.mjs) and in a browser (page.html).

/**
 * Returns what was heard as JSON text; raises when something does not come within 10 s.
 * `protobuf` is protobufjs with its extension for descriptors, `socket` a WebSocket that is opening.
 */
export async function converse(FoxgloveClient, protobuf, socket) {
  const client = new FoxgloveClient({ ws: socket });

  const heard = { statuses: [], messages: {}, graph: [], times: 0, parameterUpdates: [] };
  const channels = new Map();
  const services = new Map();
  const subscriptions = new Map();
  const answers = new Map();
  const waiting = [];

  function happened() {
    for (let index = waiting.length - 1; index >= 0; index--) {
      if (waiting[index].condition()) {
        waiting.splice(index, 1)[0].resolve();
      }
    }
  }

  function until(what, condition) {
    if (condition()) {
      return Promise.resolve();
    }
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => reject(new Error(`not within 10 s: ${what}`)), 10_000);
      waiting.push({
        condition,
        resolve: () => {
          clearTimeout(timer);
          resolve();
        },
      });
    });
  }

  function decoder(channel) {
    const schema = Uint8Array.from(atob(channel.schema), (character) => character.charCodeAt(0));
    const root = protobuf.Root.fromDescriptor(schema);
    const type = root.lookupType(channel.schemaName);
    return (data) => type.toObject(type.decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength)), { bytes: Array });
  }

  const failed = new Promise((_, reject) => client.on("error", reject));
  client.on("serverInfo", (info) => {
    heard.serverInfo = info;
    happened();
  });
  client.on("status", (status) => {
    heard.statuses.push([status.level, status.message]);
    happened();
  });
  client.on("time", () => {
    heard.times += 1;
    happened();
  });
  client.on("advertise", (items) => {
    for (const channel of items) {
      channels.set(channel.topic, channel);
    }
    happened();
  });
  client.on("unadvertise", (ids) => {
    for (const [topic, channel] of channels) {
      if (ids.includes(channel.id)) {
        channels.delete(topic);
      }
    }
    happened();
  });
  client.on("advertiseServices", (items) => {
    for (const service of items) {
      services.set(service.name, service);
    }
    happened();
  });
  client.on("message", ({ subscriptionId, data }) => {
    const { topic, decode } = subscriptions.get(subscriptionId);
    (heard.messages[topic] ??= []).push(decode(data));
    happened();
  });
  client.on("parameterValues", ({ parameters, id }) => {
    if (id == undefined) {
      heard.parameterUpdates.push(...parameters);
    } else {
      answers.set(id, parameters);
    }
    happened();
  });
  client.on("connectionGraphUpdate", (update) => {
    heard.graph.push(update);
    happened();
  });
  client.on("serviceCallResponse", ({ callId, encoding, data }) => {
    answers.set(callId, [encoding, JSON.parse(new TextDecoder().decode(data))]);
    happened();
  });
  client.on("serviceCallFailure", ({ callId, message }) => {
    answers.set(callId, ["failure", message]);
    happened();
  });
  client.on("fetchAssetResponse", ({ requestId, data, error }) => {
    answers.set(`asset ${requestId}`, data == undefined ? error : new TextDecoder().decode(data));
    happened();
  });

  async function subscribe(topic) {
    await until(`channel ${topic}`, () => channels.has(topic));
    const channel = channels.get(topic);
    subscriptions.set(client.subscribe(channel.id), { topic, decode: decoder(channel) });
    await until(`a message on ${topic}`, () => heard.messages[topic] != undefined);
  }

  function call(name, callId, request) {
    const data = new TextEncoder().encode(JSON.stringify(request));
    client.sendServiceCallRequest({
      serviceId: services.get(name).id,
      callId,
      encoding: "json",
      data: new DataView(data.buffer, data.byteOffset, data.byteLength),
    });
  }

  async function talk() {
    await until("serverInfo", () => heard.serverInfo != undefined);
    heard.subprotocol = socket.protocol;

    await subscribe("/map");
    await subscribe("/scan");
    await subscribe("/scan/scan");
    await subscribe("/things");

    client.getParameters([], "all");
    await until("parameters", () => answers.has("all"));
    heard.parameters = answers.get("all");
    client.subscribeParameterUpdates([]);
    client.setParameters([{ name: "/robot/gain", value: 3 }], "set");
    await until("set parameters", () => answers.has("set") && heard.parameterUpdates.length > 0);
    heard.parametersSet = answers.get("set");

    await until("service", () => services.has("/switch"));
    heard.service = services.get("/switch");
    call("/switch", 1, { data: true });
    call("/switch", 2, { data: false });
    await until("answers", () => answers.has(1) && answers.has(2));
    heard.calls = [answers.get(1), answers.get(2)];

    client.subscribeConnectionGraph();
    await until("graph", () => heard.graph.length > 0);

    client.fetchAsset("package://robot/robot.urdf", 1);
    client.fetchAsset("package://robot/nothing", 2);
    await until("assets", () => answers.has("asset 1") && answers.has("asset 2"));
    heard.assets = [answers.get("asset 1"), answers.get("asset 2")];

    const published = client.advertise({ topic: "/cmd_vel", encoding: "json", schemaName: "geometry_msgs/Twist" });
    const twist = { linear: { x: 0.5, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 1 } };
    client.sendMessage(published, new TextEncoder().encode(JSON.stringify(twist)));
    await until("the message back", () => channels.has("/heard"));

    await until("time", () => heard.times > 0);
  }

  await Promise.race([talk(), failed]);
  client.close();
  return JSON.stringify(heard, (_, value) => (typeof value === "bigint" ? String(value) : value));
}
