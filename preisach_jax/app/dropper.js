// A box for files: one that is dropped, or chosen by mouse or keyboard, is sent in pieces at once.

const PIECE = 8_000_000 // a websocket takes messages of 20 MB at most

export function render({ model }) {
  const box = document.createElement("label")
  box.className = model.compact ? "drop compact" : "drop"
  const input = document.createElement("input")
  input.type = "file"
  input.multiple = model.several
  const text = document.createElement("span")
  text.textContent = model.text
  const hint = document.createElement("small")
  hint.textContent = model.hint
  box.append(input, text, hint)

  let number = 0
  async function send(file) {
    const mine = ++number
    const common = { name: file.name, size: file.size, number: mine }
    if (file.size > model.most_bytes) {
      model.send_msg({ ...common, data: new ArrayBuffer(0) })
      return
    }
    for (let begin = 0; begin === 0 || begin < file.size; begin += PIECE) {
      if (file.size > PIECE) {
        text.textContent = `Sending ${file.name}: ${Math.round((100 * begin) / file.size)} %`
      }
      const data = await file.slice(begin, begin + PIECE).arrayBuffer()
      if (mine !== number) return // another file came meanwhile
      model.send_msg({ ...common, data })
    }
    text.textContent = model.text
  }

  async function sendAll(files) {
    for (const file of model.several ? [...files] : [...files].slice(0, 1)) await send(file)
  }

  input.onchange = () => {
    sendAll(input.files)
    input.value = "" // the same file may be chosen again
  }

  // Some programs give files without naming the type at once, so whatever hovers is welcome.
  const place = model.whole_page ? document : box
  const listeners = {
    dragover: (event) => {
      event.preventDefault()
      box.classList.add("hovered")
    },
    dragleave: () => box.classList.remove("hovered"),
    drop: (event) => {
      event.preventDefault()
      event.stopPropagation()
      box.classList.remove("hovered")
      sendAll(event.dataTransfer.files)
    },
  }
  for (const [name, listener] of Object.entries(listeners)) place.addEventListener(name, listener)
  model.on("compact", () => box.classList.toggle("compact", model.compact))
  model.on("text", () => {
    text.textContent = model.text
  })
  model.on("remove", () => {
    for (const [name, listener] of Object.entries(listeners)) {
      place.removeEventListener(name, listener)
    }
  })
  return box
}
