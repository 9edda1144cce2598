// The connection to the server: one stream a page, and requests. The token stands in the address after `#`, is taken out
// of it, and lives as long as this tab.

const KEY = "heronry-token";

export function takeToken() {
  const found = /^#token=([\w-]+)$/.exec(location.hash);
  if (found) {
    sessionStorage.setItem(KEY, found[1]);
    history.replaceState(null, "", location.pathname);
  }
}

const token = () => sessionStorage.getItem(KEY) ?? "";
const headers = () => (token() ? { authorization: `Bearer ${token()}` } : {});

export function fileAddress(path) {
  return token() ? `${path}?token=${encodeURIComponent(token())}` : path;
}

export async function get(path) {
  const answer = await fetch(path, { headers: headers(), cache: "no-store" });
  if (!answer.ok) throw new Error((await answer.json()).sentence);
  return answer;
}

export async function post(path, data, signal) {
  const answer = await fetch(path, {
    method: "POST", headers: { ...headers(), "content-type": "application/json" }, body: JSON.stringify(data), signal,
  });
  return answer.json();
}

// Reads the stream until `stop` is called, and opens it again when it breaks. `take(kind, data)` gets every event.
export function open(address, take, broken) {
  const stopping = new AbortController();
  (async () => {
    while (!stopping.signal.aborted) {
      try {
        const answer = await fetch(address, { headers: headers(), cache: "no-store", signal: stopping.signal });
        if (!answer.ok) throw new Error((await answer.json()).sentence);
        await read(answer.body.pipeThrough(new TextDecoderStream()).getReader(), take);
        broken("the server has closed the stream");
      } catch (error) {
        if (stopping.signal.aborted) return;
        broken(error instanceof TypeError ? "the server does not answer" : error.message);
      }
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  })();
  return () => stopping.abort();
}

async function read(reader, take) {
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const events = text.split("\n\n");
    text = events.pop();
    for (const one of events) {
      const [kind, data] = one.split("\n");
      take(kind.slice(7), JSON.parse(data.slice(6)));
    }
  }
}
