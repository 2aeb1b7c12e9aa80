// How much is drawn between two frames. A graphics card does all at once; a processor in its place would block the page.

const LITTLE = 25, MUCH = 45; // ms that a part takes up to which the next one is larger, from which on it is smaller

// Work goes to the card in parts, the next one when the one before is done, which a fence tells.
export class Pacer {
  constructor(gl, first, least) {
    Object.assign(this, { gl, amount: first, least, fence: null });
  }

  // Whether the part before is done; to be asked once a frame.
  get free() {
    const { gl, fence } = this;
    if (!fence) return true;
    if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(fence);
    this.fence = null;
    const took = performance.now() - this.since;
    if (this.full && took < LITTLE) this.amount *= 2;
    if (took > MUCH) this.amount = Math.max(this.amount / 2, this.least);
    return true;
  }

  // After a part was drawn. `full`: it was as much as might be.
  given(full) {
    const { gl } = this;
    Object.assign(this, { full, since: performance.now(), fence: gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0) });
    gl.flush();
  }
}
