// A figure opens over the page; the wheel or + and - zoom it, dragging moves it, Escape closes it.
const shown = document.querySelector("dialog.zoom")
const frame = shown.querySelector(".frame")
const picture = frame.appendChild(document.createElement("img"))
let [scale, whole] = [1, 0] // and the width at which all of the figure is seen

function zoom_to(wanted, x = frame.clientWidth / 2, y = frame.clientHeight / 2) {
  const next = Math.min(Math.max(wanted, 1), 20)
  // What is under the pointer stays there.
  const [left, top] = [(frame.scrollLeft + x) * (next / scale), (frame.scrollTop + y) * (next / scale)]
  scale = next
  picture.style.width = `${whole * scale}px`
  frame.scrollTo(left - x, top - y)
}

function open(image) {
  picture.src = image.src
  picture.alt = image.alt
  shown.showModal()
  const ratio = image.naturalWidth / image.naturalHeight
  whole = Math.min(frame.clientWidth, frame.clientHeight * ratio)
  zoom_to(1)
}

for (const image of document.querySelectorAll("figure img")) {
  image.tabIndex = 0
  image.setAttribute("role", "button")
  image.title = "Open and zoom"
  image.addEventListener("click", () => open(image))
  image.addEventListener("keydown", (event) => {
    if (event.key === "Enter" || event.key === " ") {
      event.preventDefault()
      open(image)
    }
  })
}

frame.addEventListener(
  "wheel",
  (event) => {
    event.preventDefault()
    const box = frame.getBoundingClientRect()
    zoom_to(scale * Math.exp(-event.deltaY / 400), event.clientX - box.left, event.clientY - box.top)
  },
  { passive: false },
)
shown.addEventListener("keydown", (event) => {
  if (event.key === "+" || event.key === "=") zoom_to(scale * 1.4)
  if (event.key === "-") zoom_to(scale / 1.4)
})
frame.addEventListener("pointermove", (event) => {
  if (event.buttons === 1) frame.scrollBy(-event.movementX, -event.movementY)
})
picture.addEventListener("dragstart", (event) => event.preventDefault())
shown.querySelector("button").addEventListener("click", () => shown.close())
