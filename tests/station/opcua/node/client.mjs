// A client that shares no code with the server: keeps each result that it is told of, and acknowledges it then.
//
// node client.mjs '{"url", "certificate", "key", "server", "pki", "user", "password", "kept", "until"}'
// Each result is a line of `kept`: its id, and the verdict in the content that was fetched. One that comes again is a
// line of `kept`.again. It ends when `until` results are there, or at a signal.
import { appendFileSync, existsSync, readFileSync } from "node:fs";
import opcua from "node-opcua-client";
import pki from "node-opcua-certificate-manager";

const asked = JSON.parse(process.argv[2]);
const RESULT = "http://opcfoundation.org/UA/Machinery/Result/";
const known = new Set(
  existsSync(asked.kept) ? readFileSync(asked.kept, "utf8").split("\n").filter(Boolean).map((line) => JSON.parse(line).id) : [],
);

const client = opcua.OPCUAClient.create({
  applicationName: "node client",
  applicationUri: "urn:lostmotion:test:client",
  certificateFile: asked.certificate,
  privateKeyFile: asked.key,
  serverCertificate: readFileSync(asked.server),
  securityMode: opcua.MessageSecurityMode.SignAndEncrypt,
  securityPolicy: opcua.SecurityPolicy.Basic256Sha256,
  clientCertificateManager: new pki.OPCUACertificateManager({
    rootFolder: asked.pki,
    automaticallyAcceptUnknownCertificate: true,
  }),
  endpointMustExist: false,
  keepSessionAlive: true,
  connectionStrategy: { initialDelay: 200, maxDelay: 500, maxRetry: 100 },
});

await client.connect(asked.url);
// Its own reconnection to a server that was killed does not always come to an end: whoever started it starts it anew.
client.on("connection_lost", () => process.exit(2));
client.on("start_reconnection", () => process.exit(2));
const session = await client.createSession({ type: opcua.UserTokenType.UserName, userName: asked.user, password: asked.password });
const namespaces = await session.readNamespaceArray();
const ours = namespaces.indexOf("urn:lostmotion:opcua");
const results = `ns=${ours};s=Machine.ResultManagement`;
// A call whose answer went down with the server is never answered: then this client ends, and is started anew.
const ANSWER_MS = 10000;
const silence = () => new Promise((_, reject) => setTimeout(() => reject(new Error("no answer")), ANSWER_MS).unref());
const call = async (name, ...inputArguments) => {
  const asked = session.call({ objectId: results, methodId: `${results}.${name}`, inputArguments });
  return (await Promise.race([asked, silence()])).outputArguments;
};

let chain = Promise.resolve();
let ended;
const end = new Promise((resolve) => (ended = resolve));

async function take(id) {
  if (known.has(id)) {
    appendFileSync(`${asked.kept}.again`, `${JSON.stringify({ id })}\n`);
    return acknowledge(id);
  }
  const [, result, error] = await call(
    "GetResultById",
    { dataType: opcua.DataType.String, value: id },
    { dataType: opcua.DataType.Int32, value: 0 },
  );
  const content = error.value === 0 ? JSON.parse(result.value.resultContent[0].value) : {};
  appendFileSync(asked.kept, `${JSON.stringify({ id, verdict: content.verdict ?? null })}\n`);
  known.add(id);
  await acknowledge(id);
}

async function acknowledge(id) {
  const [, refused] = await call("AcknowledgeResults", {
    dataType: opcua.DataType.String,
    arrayType: opcua.VariantArrayType.Array,
    value: [id],
  });
  if (refused.value !== 0) throw new Error(`acknowledge ${id}: ${refused.value}`);
  if (known.size >= asked.until) ended();
}

const subscription = await session.createSubscription2({
  requestedPublishingInterval: 50,
  requestedLifetimeCount: 1000,
  requestedMaxKeepAliveCount: 20,
  maxNotificationsPerPublish: 0,
  publishingEnabled: true,
  priority: 1,
});
const item = await subscription.monitor(
  { nodeId: results, attributeId: opcua.AttributeIds.EventNotifier },
  {
    queueSize: 1000,
    samplingInterval: 0,
    discardOldest: true,
    filter: opcua.constructEventFilter([`${namespaces.indexOf(RESULT)}:Result.${namespaces.indexOf(RESULT)}:ResultMetaData.${namespaces.indexOf(RESULT)}:ResultId`]),
  },
  opcua.TimestampsToReturn.Both,
);
item.on("changed", (fields) => {
  chain = chain.then(() => take(fields[0].value)).catch((error) => {
    console.error(String(error));
    process.exit(1);
  });
});
console.log("listens");
process.on("SIGTERM", () => process.exit(0));
if (known.size >= asked.until) ended();
await end;
await chain;
await client.disconnect();
process.exit(0);
