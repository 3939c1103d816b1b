// What the server says of one map, with the rights of a token or of a reader.

export class Maps {
  constructor(token) {
    this.headers = token ? { Authorization: `Bearer ${token}` } : {};
  }

  // Ask of this map from now on; without a name, of the only one.
  async open(name) {
    const all = new URL("../maps", location.href);
    if (!name) {
      const names = (await (await answered(await fetch(all, { headers: this.headers }))).json()).map((map) => map.name);
      if (names.length !== 1) throw new Error(names.length ? `add ?map=NAME to the address: ${names.join(", ")}` : "there are no maps: semmap import makes one");
      name = names[0];
    }
    this.name = name;
    this.at = `${all}/${encodeURIComponent(name)}/`;
  }

  async get(path) {
    return answered(await fetch(this.at + path, { headers: this.headers }));
  }

  // The answer of an operation with its arguments by name.
  async ask(operation, values) {
    const headers = { ...this.headers, "Content-Type": "application/json" };
    const body = JSON.stringify(values);
    const reply = await fetch(this.at + operation, { method: "POST", headers, body });
    return (await answered(reply)).json();
  }

  // Call with each event after a cursor, for ever: a connection that ends is opened again.
  async follow(cursor, hear, say) {
    for (;;) {
      try {
        const reply = await this.get(`events?since=${encodeURIComponent(cursor)}`);
        say("live");
        for await (const event of events(reply.body)) {
          cursor = event.cursor;
          hear(event);
        }
      } catch (error) {
        if (error.status === 400) throw error; // changes after the cursor are not kept
        say(`away: ${error.message}`);
      }
      await new Promise((done) => setTimeout(done, 1000));
    }
  }
}

async function answered(reply) {
  if (reply.ok) return reply;
  throw Object.assign(new Error(reason(await reply.text()) || reply.statusText), { status: reply.status });
}

// The reason in the body of an answer that is an error.
export function reason(text) {
  try {
    return JSON.parse(text).error;
  } catch {
    return text; // a text says why, too
  }
}

async function* events(stream) {
  let text = "";
  for await (const part of read(stream.pipeThrough(new TextDecoderStream()))) {
    const blocks = (text + part).split("\n\n");
    text = blocks.pop();
    for (const block of blocks) {
      const line = block.split("\n").find((each) => each.startsWith("data: "));
      if (line) yield JSON.parse(line.slice(6));
    }
  }
}

async function* read(stream) {
  const reader = stream.getReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) yield part.value;
}
