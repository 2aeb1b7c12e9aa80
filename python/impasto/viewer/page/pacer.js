// How much is drawn between two frames. A graphics card does all at once; a processor in its place would block the page.

const LITTLE = 12, MUCH = 25; // ms that a part takes up to which the next one is larger, from which on it is smaller
const AHEAD = 2; // parts that it has at once: one is drawn while the next one waits
export const POLL = 4; // ms between two looks at what is done

// Work goes to the card in parts. Fences tell which of them are done.
export class Pacer {
  constructor(gl, first, least) {
    Object.assign(this, { gl, amount: first, least, parts: [], done: 0 });
  }

  // What is drawn at once without a wait that is felt.
  get most() {
    return AHEAD * this.amount;
  }

  // Whether another part may be given; the answer changes between tasks of the browser only.
  get free() {
    const { gl, parts } = this;
    while (parts.length && gl.getSyncParameter(parts[0].fence, gl.SYNC_STATUS) === gl.SIGNALED) {
      const { fence, since, full } = parts.shift(), took = performance.now() - Math.max(since, this.done);
      gl.deleteSync(fence);
      this.done = performance.now();
      if (full && took < LITTLE) this.amount *= 2;
      if (took > MUCH) this.amount = Math.max(this.amount / 2, this.least);
    }
    return parts.length < AHEAD;
  }

  // After a part was drawn. `full`: it was as much as might be.
  given(full) {
    const { gl } = this;
    this.parts.push({ full, since: performance.now(), fence: gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0) });
    gl.flush();
  }
}
