"""The registry of readers: one file a format, told by how a file begins or by its ending.

Text without a reader of its own is delimiter-separated; `settings` finds its table below settings.
"""

from preisach_jax.record.readers.arrow import FEATHER, PARQUET
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.readers.hdf5 import HDF5
from preisach_jax.record.readers.json_text import JSON
from preisach_jax.record.readers.lvm import LVM
from preisach_jax.record.readers.mat import MAT
from preisach_jax.record.readers.micromag import is_micromag, read_micromag
from preisach_jax.record.readers.npz import NPY, NPZ
from preisach_jax.record.readers.oscilloscopes import INFINIIUM, RIGOL, SIGLENT, TEKTRONIX
from preisach_jax.record.readers.tdms import TDMS
from preisach_jax.record.readers.workbook import WORKBOOK

MICROMAG = Reader(
    "MicroMag .forc", is_text=is_micromag, read_text=read_micromag, note="reversal curves"
)

BINARY: tuple[Reader, ...] = (NPZ, NPY, MAT, PARQUET, FEATHER, HDF5, TDMS, WORKBOOK)
TEXT: tuple[Reader, ...] = (MICROMAG, JSON, LVM, RIGOL, SIGLENT, TEKTRONIX, INFINIIUM)
