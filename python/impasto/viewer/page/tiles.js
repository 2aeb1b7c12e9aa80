// Tiles by name: asked for, decompressed and kept.

const LARGEST_TILE = 64 << 20; // bytes of a decompressed tile: 256 x 256 texels of 1 kB
const AT_ONCE = 6;

const jsonOf = bytes => JSON.parse(new TextDecoder().decode(bytes));

// The codes of a PNG as they are.
const pictureOf = bytes =>
  createImageBitmap(new Blob([bytes], { type: "image/png" }), { colorSpaceConversion: "none", premultiplyAlpha: "none" });

async function decompressed(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")).getReader();
  const parts = [];
  for (let size = 0; ;) {
    const { done, value } = await stream.read();
    if (done) break;
    size += value.length;
    if (size > LARGEST_TILE) throw new Error("a tile is too large");
    parts.push(value);
  }
  return new Blob(parts).arrayBuffer();
}

// What the files of a painting hold, of what loads the bytes of one by its name.
export const filesOf = load => ({
  // `folder`: before the names of the tiles of another painting.
  tile: (name, folder = "") => load(`${folder}tiles/${name}`).then(decompressed),
  effects: () => load("effects").then(jsonOf),
  // An image from a file would not be readable by WebGL: a page from a disk has no origin.
  photograph: number => load(`photographs/${number}`).then(pictureOf),
  environment: number => load(`environments/${number}`).then(decompressed),
  samples: (row, column) => load(`samples/${row}-${column}`).then(jsonOf),
});

export class Tiles {
  constructor(source, arrived, folder) {
    this.source = source;
    this.folder = folder;
    this.arrived = arrived;
    this.known = new Map(); // name: { state, buffer }
    this.queue = [];
    this.running = 0;
  }

  // Ask for tiles, the first most; what waits and is not among them is forgotten.
  want(names) {
    this.queue = names.filter(name => !this.known.has(name));
    this.next();
  }

  next() {
    while (this.running < AT_ONCE && this.queue.length) {
      const name = this.queue.shift();
      if (!this.known.has(name)) this.load(name);
    }
  }

  load(name) {
    const entry = { buffer: null, failed: false };
    this.known.set(name, entry);
    this.running++;
    entry.promise = this.source.tile(name, this.folder)
      .then(buffer => { entry.buffer = buffer; })
      .catch(error => { entry.failed = true; console.error(error); })
      .then(() => {
        this.running--;
        this.arrived(name, entry);
        this.next();
        return entry.buffer;
      });
    return entry.promise;
  }

  // The numbers of a tile, loaded if need be.
  get(name) {
    const entry = this.known.get(name);
    if (entry) return entry.buffer ? Promise.resolve(entry.buffer) : entry.promise;
    return this.load(name);
  }

  forget(name) {
    this.known.delete(name);
  }
}
