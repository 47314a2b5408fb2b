from typing import Any

void: Any
float64: Any
int32: Any
int64: Any
CPointer: Any
