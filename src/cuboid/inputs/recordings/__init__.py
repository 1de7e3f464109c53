"""Operations on recordings for users: opening with registration, inspection, conversion."""
