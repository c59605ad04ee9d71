// WebGL2 in a few words: programs, meshes with named attributes, lines, textures.

export function createContext(canvas) {
  const probe = document.createElement("canvas").getContext("webgl2"), named = probe?.getExtension("WEBGL_debug_renderer_info");
  const isSoftware = /swiftshader|llvmpipe|software/i.test(named ? probe.getParameter(named.UNMASKED_RENDERER_WEBGL) : "");
  const gl = canvas.getContext("webgl2", {antialias: !isSoftware, alpha: false, powerPreference: "high-performance"});
  if (gl) { gl.isSoftware = isSoftware; gl.enable(gl.DEPTH_TEST); gl.depthFunc(gl.LEQUAL); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA); }
  return gl;
}

export class Program {
  constructor(gl, [vertex, fragment]) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(this.program));
    this.uniforms = {};
    for (let n = 0; n < gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS); n++) {
      const found = gl.getActiveUniform(this.program, n), name = found.name.replace("[0]", "");
      this.uniforms[name] = [gl.getUniformLocation(this.program, found.name), found.type];
    }
  }

  use(values) {
    this.gl.useProgram(this.program);
    this.set(values);
  }

  set(values) {
    const gl = this.gl;
    for (const [name, value] of Object.entries(values)) {
      const [at, type] = this.uniforms[name] || [];
      if (!at) continue;
      if (type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(at, false, value);
      else if (type === gl.SAMPLER_2D) gl.bindTexture(gl.TEXTURE_2D, value);  // of unit 0, as every sampler
      else gl[`uniform${value.length || 1}fv`](at, value.length ? value : [value]);
    }
  }
}

// Triangles or points whose attributes are arrays by name, each with its number of values a vertex.
export class Mesh {
  constructor(gl, program, attributes, indices = null, kind = gl.TRIANGLES) {
    this.gl = gl; this.kind = kind;
    this.vao = gl.createVertexArray();
    gl.bindVertexArray(this.vao);
    for (const [name, [values, size]] of Object.entries(attributes)) {
      const at = gl.getAttribLocation(program.program, name);
      this.count = values.length / size;
      if (at < 0) continue;
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values instanceof Float32Array ? values : new Float32Array(values), gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, gl.FLOAT, false, 0, 0);
    }
    this.indexed = Boolean(indices);
    if (indices) {
      this.count = indices.length;
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    }
    gl.bindVertexArray(null);
  }

  draw() {
    this.gl.bindVertexArray(this.vao);
    if (this.indexed) this.gl.drawElements(this.kind, this.count, this.gl.UNSIGNED_INT, 0);
    else this.gl.drawArrays(this.kind, 0, this.count);
  }
}

// Lines that may change: a polyline, or separate pieces.
export class Lines {
  constructor(gl, program, isPolyline) {
    this.gl = gl; this.isPolyline = isPolyline; this.pieces = 0;
    this.vao = gl.createVertexArray();
    gl.bindVertexArray(this.vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, -1, 1, -1, 0, 1, 1, 1]), gl.STATIC_DRAW);
    const corner = gl.getAttribLocation(program.program, "corner");
    gl.enableVertexAttribArray(corner);
    gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
    this.buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    for (const [name, offset] of [["a", 0], ["b", 12]]) {
      const at = gl.getAttribLocation(program.program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, 3, gl.FLOAT, false, isPolyline ? 12 : 24, offset);
      gl.vertexAttribDivisor(at, 1);
    }
    gl.bindVertexArray(null);
  }

  set(points) {
    const gl = this.gl, count = points.length;
    this.pieces = this.isPolyline ? Math.max(0, count - 1) : Math.floor(count / 2);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points.flat()), gl.DYNAMIC_DRAW);
  }

  draw() {
    if (!this.pieces) return;
    this.gl.bindVertexArray(this.vao);
    this.gl.drawArraysInstanced(this.gl.TRIANGLE_STRIP, 0, 4, this.pieces);
  }
}

export function texture(gl, source, repeats) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  if (source) gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, source);
  else gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  const way = repeats ? gl.REPEAT : gl.CLAMP_TO_EDGE;
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, way);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, way);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, repeats ? (gl.isSoftware ? gl.LINEAR_MIPMAP_NEAREST : gl.LINEAR_MIPMAP_LINEAR) : gl.LINEAR);
  if (repeats) gl.generateMipmap(gl.TEXTURE_2D);
  return made;
}

// A tile of noise: its height in red, its slopes in green and blue.
export function noiseTexture(gl, size = 256) {
  let state = 7;
  const random = () => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
  const height = new Float32Array(size * size);
  for (const [cells, weight] of [[4, 0.3], [8, 0.26], [16, 0.2], [32, 0.14], [64, 0.1]]) {
    const grid = Float32Array.from({length: cells * cells}, random);
    for (let y = 0; y < size; y++) for (let x = 0; x < size; x++) {
      const u = x * cells / size, v = y * cells / size, i = Math.floor(u), j = Math.floor(v);
      const smooth = t => t * t * (3 - 2 * t), s = smooth(u - i), t = smooth(v - j);
      const at = (a, b) => grid[((j + b) % cells) * cells + (i + a) % cells];
      height[y * size + x] += weight * ((at(0, 0) * (1 - s) + at(1, 0) * s) * (1 - t) + (at(0, 1) * (1 - s) + at(1, 1) * s) * t);
    }
  }
  const pixels = new Uint8ClampedArray(4 * size * size);
  for (let y = 0; y < size; y++) for (let x = 0; x < size; x++) {
    const at = (a, b) => height[((y + b + size) % size) * size + (x + a + size) % size];
    pixels.set([255 * at(0, 0), 128 + 1500 * (at(-1, 0) - at(1, 0)), 128 + 1500 * (at(0, -1) - at(0, 1)), 255], 4 * (y * size + x));
  }
  return texture(gl, new ImageData(pixels, size, size), true);
}
