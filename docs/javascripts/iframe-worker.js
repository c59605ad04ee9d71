// The search of the built pages runs in a Worker, which browsers refuse to pages that are opened as files. There an
// iframe takes its place: it runs the same script, and messages are handed to and fro as events.
(() => {
  if (location.protocol !== "file:") return

  const load = (inner, url) =>
    new Promise((loaded, failed) => {
      const script = inner.document.createElement("script")
      script.src = new URL(url, location.href)
      script.onload = loaded
      script.onerror = failed
      inner.document.body.appendChild(script)
    })

  // The theme looks for this name to find out from where its search loads languages.
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      document.body.appendChild(this.frame)
      this.inner = this.frame.contentWindow
      this.inner.document.open()
      this.inner.document.write("<body></body>")
      this.inner.document.close()
      this.inner.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }))
      this.inner.importScripts = (...urls) =>
        urls.reduce((before, each) => before.then(() => load(this.inner, each)), Promise.resolve())
      this.ready = load(this.inner, url)
    }

    postMessage(data) {
      this.ready.then(() => this.inner.dispatchEvent(new this.inner.MessageEvent("message", { data })))
    }

    terminate() {
      this.frame.remove()
    }
  }
})()
