// The socket: JSON both ways, frames as binary, and reconnection when it breaks.

const PATIENCE = [250, 500, 1000, 2000, 4000]; // ms until the next attempt; the last one repeats
const FULL = 1013; // the code with which the server closes the connection of one page too many

/** A name by which the server recognises this page; it lasts as long as the tab. */
function pageName() {
  const bytes = crypto.getRandomValues(new Uint8Array(12));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export class Connection {
  /**
   * @param {{open: () => object, message: (type: string, content: any) => void,
   *          frame: (header: object, image: Blob) => Promise<void>,
   *          file: (name: string, content: Blob) => void,
   *          state: (isOpen: boolean, isFull?: boolean) => void}} listener `open` gives the size to say
   *          hello with.
   */
  constructor(listener) {
    this.listener = listener;
    this.page = pageName();
    this.tries = 0;
    this.parts = null;
    this.pieces = [];
    this.shown = Promise.resolve();
    this.connect();
  }

  get isOpen() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  /** Send a message; without a connection it is lost. */
  send(type, members = {}) {
    if (this.isOpen) this.socket.send(JSON.stringify({ type, ...members }));
  }

  connect() {
    const url = new URL("socket", location.href);
    url.protocol = "ws:";
    const socket = new WebSocket(url);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    let isWelcome = false; // where too many pages are open, the connection is closed at once
    socket.onopen = () => this.send("hello", { page: this.page, ...this.listener.open() });
    socket.onmessage = (event) => {
      if (!isWelcome) {
        isWelcome = true;
        this.tries = 0;
        this.listener.state(true);
      }
      this.receive(event.data, socket);
    };
    socket.onclose = (event) => {
      this.listener.state(false, event.code === FULL);
      setTimeout(() => this.connect(), PATIENCE[Math.min(this.tries++, PATIENCE.length - 1)]);
    };
  }

  receive(data, socket) {
    if (typeof data === "string") {
      const { type, content } = JSON.parse(data);
      this.listener.message(type, content);
      return;
    }
    const length = new DataView(data).getUint32(0);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    // each connection has its own numbers, and a picture may be decoded after it was lost
    const acknowledge = () => {
      if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type: "acknowledge", message: header.message }));
    };
    if (header.file) {
      this.receiveFile(header, new Uint8Array(data, 4 + length));
      acknowledge();
      return;
    }
    if (header.part === 0) this.parts = { header, pieces: [] }; // a newer picture ends one that is not complete
    this.parts.pieces.push(new Uint8Array(data, 4 + length));
    if (header.part < header.parts - 1) {
      acknowledge();
      return;
    }
    const { header: about, pieces } = this.parts;
    const image = new Blob(pieces, { type: about.encoding });
    // one after the other: images are decoded in other threads, and a small one would overtake
    this.shown = this.shown.then(() => this.listener.frame(about, image)).finally(acknowledge).catch(report);
  }

  receiveFile(header, piece) {
    if (header.is_first) this.pieces = [];
    this.pieces.push(piece);
    if (!header.is_last) return;
    this.listener.file(header.file, new Blob(this.pieces, { type: header.encoding }));
    this.pieces = [];
  }
}

function report(error) {
  console.error(error);
}
