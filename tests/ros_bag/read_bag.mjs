// Decodes every message of an MCAP file with the readers that Foxglove and Lichtblick are made of, as lines of JSON.
import { open } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers } from "@mcap/support";
import { parse } from "@foxglove/rosmsg";
import { parseRos2idl } from "@foxglove/ros2idl-parser";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

const file = await open(process.argv[2], "r");
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await file.read(buffer, 0, Number(length), Number(offset));
    return buffer;
  },
};
const plain = (key, value) =>
  typeof value === "bigint" ? Number(value) : ArrayBuffer.isView(value) ? Array.from(value, (one) => plain("", one)) : value;
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: await loadDecompressHandlers(),
});
const decoders = new Map();
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const channel = reader.channelsById.get(message.channelId);
  try {
    if (!decoders.has(channel.id)) {
      const schema = reader.schemasById.get(channel.schemaId);
      const text = new TextDecoder().decode(schema.data);
      const known = schema.encoding === "ros2idl" ? parseRos2idl(text) : parse(text, { ros2: true });
      decoders.set(channel.id, new MessageReader(known));
    }
    const value = decoders.get(channel.id).readMessage(message.data);
    console.log(JSON.stringify({ topic: channel.topic, value }, plain));
  } catch (error) {
    console.log(JSON.stringify({ topic: channel.topic, error: String(error) }));
  }
}
